"""Where the robot stands and how it drives: approach_poses, register_layout."""
