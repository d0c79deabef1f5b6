"""Off-screen cameras of the DROID setup, and the pictures that policies and recordings get."""
