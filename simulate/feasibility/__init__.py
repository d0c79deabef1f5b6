"""Whether tasks, references, grades and controls do what the benchmark says, and the pages on it."""
