"""Validation of tasks, references, grades and controls, and the pages that report it."""
