"""Keep readings in a file, and read such files again."""
