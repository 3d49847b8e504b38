"""The command read_tag."""
