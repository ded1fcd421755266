"""The page on the dissertation, and its table as a document."""
