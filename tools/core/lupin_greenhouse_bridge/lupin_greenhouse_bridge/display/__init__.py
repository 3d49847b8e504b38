"""Show readings: show_readings, readings_page, plot_report. Never asks the bridge."""
