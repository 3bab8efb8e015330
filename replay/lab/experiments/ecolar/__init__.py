"""`ecolar`: a real zone whose truth nobody knows (5.2)."""
