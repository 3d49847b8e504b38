"""The mission at the other end of the contract: visit the tags, read each once, report."""
