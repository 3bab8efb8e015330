"""What a person writes in a configuration, value by value, and how a mistake becomes a sentence."""
