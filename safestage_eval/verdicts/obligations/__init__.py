"""Each kind of obligation: its margin, its witness, its words and how far it looks ahead."""
