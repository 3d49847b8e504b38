"""What the bridge loads: the two files, the layout and the simulator. Does not import ROS."""
