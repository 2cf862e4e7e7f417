"""The rclpy base of every node: parameters with ranges, diagnostics, quality of service, start and stop."""
