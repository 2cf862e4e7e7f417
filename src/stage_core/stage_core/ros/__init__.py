"""The rclpy base of every node: parameters with ranges, diagnostics, start and stop."""
