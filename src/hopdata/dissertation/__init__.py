"""The dissertation beside hopdata: each of its results, as printed and as found here.

A product (`hopdata.products`) that stands above all others. Its parts compute, its
items hold the words, its page shows both:

- ``parts/<name>.py`` measures some of the dissertation's items: rows with numbers;
- ``labelling/`` holds what the largest part measures, by subject;
- ``items/<name>.toml`` says for each of these items what the dissertation prints, and
  puts the part's numbers into words;
- ``figures/<name>.py`` draws the part's tables;
- ``making.py`` makes one part, in a process of its own, and keeps what it found;
- ``report/`` sets all of it in the order of the text, as a page and as a document.

``python -m hopdata.dissertation NAME`` makes one part and prints its rows.
"""
