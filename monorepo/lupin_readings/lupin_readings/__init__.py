"""
What becomes of readings: read_on_sight, record_readings, show_readings, readings_page.

Imported by others: detections, reading_file, report_line, rows, store, subscription.
"""
