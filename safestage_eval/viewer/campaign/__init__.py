"""The page of a campaign: rates, charts, and every finding with its evidence."""
