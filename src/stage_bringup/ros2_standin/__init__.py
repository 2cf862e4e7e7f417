"""The ros2 verbs that users need, where ros2cli is not installed."""
