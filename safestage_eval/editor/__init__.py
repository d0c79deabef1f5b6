"""What editors ask about rule files: completion, hover and diagnostics, over the language server protocol."""
