"""The run browser: a list of episodes, each with its replay and evidence, live or as files."""
