"""Completion, hover and diagnostics of rule files, over the language server protocol."""
