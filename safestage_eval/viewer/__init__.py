"""Pages for a browser: one episode or a whole campaign, each complete in one HTML file."""
