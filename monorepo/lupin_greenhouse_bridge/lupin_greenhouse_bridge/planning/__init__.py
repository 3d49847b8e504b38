# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Where the robot stands and how it drives: approach_poses, register_layout."""
