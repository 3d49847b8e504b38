"""Show readings: in RViz and Foxglove, and on a page."""
