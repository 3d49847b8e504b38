# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""What the bridge loads: the two files, the layout and the simulator. Does not import ROS."""
