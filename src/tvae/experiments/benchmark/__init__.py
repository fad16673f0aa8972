"""`tvae benchmark`: every method on the same demonstrations and in the same fresh worlds."""
