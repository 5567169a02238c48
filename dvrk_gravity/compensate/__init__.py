"""What the compensator decides, without ROS: limits, settings, and when to command at all."""
