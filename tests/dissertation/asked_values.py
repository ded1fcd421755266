"""What the sentences of a part's items ask for, and the names that its code can give."""

import ast
import re
from string import Formatter

from hopdata.dissertation.items import Item


def asked(item: Item):
    """Return the names of the values that the sentences of an item ask for."""
    sentences = [item.printed_method, item.ours, *item.reasons.values()]
    found = set()
    for sentence in sentences:
        found |= {name for _, name, _, _ in Formatter().parse(sentence) if name}
    return found


def given(text):
    """Return the patterns of the names that a module can give: its texts and keywords.

    A text with values in braces may give any name that it can become.
    """
    patterns = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            patterns.add(re.escape(node.value))
        elif isinstance(node, ast.keyword) and node.arg:
            patterns.add(re.escape(node.arg))
        elif isinstance(node, ast.JoinedStr):
            parts = []
            for part in node.values:
                is_text = isinstance(part, ast.Constant)
                parts.append(re.escape(part.value) if is_text else r"\w+")
            patterns.add("".join(parts))
    return patterns


def not_given(names, text):
    """Return the names that no text of a module can give."""
    patterns = [re.compile(pattern) for pattern in given(text)]
    return {name for name in names if not any(one.fullmatch(name) for one in patterns)}
