"""Text files that somebody else wrote, parsed without trust in their depth or size."""
