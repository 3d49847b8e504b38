"""The climate at a greenhouse tag, from the mdp-greenhouse simulator, as one ROS 2 service."""
