"""What results were made of, in a form that can be signed, and whether they can be made again."""
