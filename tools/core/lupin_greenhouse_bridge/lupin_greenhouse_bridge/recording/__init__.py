"""Write readings to a file, and read them from it: record_readings."""
