"""The simulated greenhouse: its files, its simulator, its layout. Does not import ROS."""
