"""Text: untrusted files parsed with limits on depth and size, and output safe to print."""
