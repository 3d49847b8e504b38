"""The node read_on_sight."""
