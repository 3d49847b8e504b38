"""Show readings: show_readings, readings_page. Never asks the bridge."""
