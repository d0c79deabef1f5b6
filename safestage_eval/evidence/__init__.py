"""What an episode tells: series over its frames, with what is missing in them."""
