"""Pictures and films of recorded episodes, drawn from their traces."""
