"""Rule files: TOML in, a checked and hashed rule set out. No geometry."""
