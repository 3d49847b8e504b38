# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Keep readings in a file and read them again: record_readings."""
