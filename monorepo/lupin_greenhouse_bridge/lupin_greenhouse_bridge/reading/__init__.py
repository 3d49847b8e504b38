# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Ask the bridge for readings: read_tag, read_on_sight."""
