"""Sec. 2.2, measured: what the part `labels` tells of its items, by subject.

Each module makes the rows of a few items. Data flows from `sample_by_both`, the sample
by the printed methods and by hopdata's.
"""
