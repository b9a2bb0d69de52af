"""ROS topics, messages, parameters and background work of the surface nodes."""
