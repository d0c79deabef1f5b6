"""What is measured of an episode: queries, and the stores that answer them."""
