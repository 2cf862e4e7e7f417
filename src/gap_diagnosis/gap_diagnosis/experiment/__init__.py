"""The motion that would decide best between what a session cannot tell apart."""
