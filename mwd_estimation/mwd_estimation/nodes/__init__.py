"""The only door to ROS of this package."""
