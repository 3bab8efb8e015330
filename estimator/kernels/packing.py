"""Symmetric matrices packed as their lower triangles: n (n + 1) / 2 entries, row by row."""


def packed(i: int, j: int) -> int:
    """Place of (i, j) in a packed triangle."""
    return i * (i + 1) // 2 + j if i >= j else j * (j + 1) // 2 + i
