# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Show readings: show_readings, readings_page. Never asks the bridge."""
