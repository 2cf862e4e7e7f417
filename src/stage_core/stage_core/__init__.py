"""Words that all packages share: quantities, frames, clocks, parameters, twin files, sessions.

Nothing here imports ROS or a sibling package.
"""
