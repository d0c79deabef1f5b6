"""Judge traces again: under other values, by other rules, by rules broken on purpose."""
