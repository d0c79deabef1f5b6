"""The DROID arm as a MuJoCo model."""
