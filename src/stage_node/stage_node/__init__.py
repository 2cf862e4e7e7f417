"""The rclpy base of every node.

Parameters with ranges, diagnostics, quality of service, start and stop.
"""
