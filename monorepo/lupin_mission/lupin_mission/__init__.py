"""A mission that visits the tags, reads each once, and reports."""
