"""A ROS 2 service that returns simulated climate readings for a greenhouse AprilTag."""
