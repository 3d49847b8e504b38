"""Ask the bridge for readings: read_tag, read_on_sight."""
