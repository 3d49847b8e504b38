"""
Where the robot stands and how it drives: approach_poses, register_layout.

Imported by others: approach, grid, occupancy, overrides, poses, registration, route, tag_poses, viewpoints,
walls.
"""
