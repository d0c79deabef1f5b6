"""What stands before every server: whom it answers, how much it takes, and that one message ends nothing."""
