"""The camera's side of the mission: whether the expected tag is in view."""
