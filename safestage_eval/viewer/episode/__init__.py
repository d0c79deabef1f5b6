"""The page of one episode: in 3-D, with its signals, limits and findings beside it."""
