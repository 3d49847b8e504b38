"""Keep readings in a file and read them again: record_readings."""
