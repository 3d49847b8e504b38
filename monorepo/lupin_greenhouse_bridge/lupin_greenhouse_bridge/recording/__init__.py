# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Write readings to a file, and read them from it: record_readings."""
