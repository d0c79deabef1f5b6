"""The benchmark's tasks: one TOML file each, and the types that those files are read into."""
