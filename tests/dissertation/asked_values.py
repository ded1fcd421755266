"""What the sentences of a part's items ask for, and the names that its code can give."""

import ast
import re
from pathlib import Path
from string import Formatter

import hopdata
from hopdata.dissertation.items import Item

PACKAGE = Path(hopdata.__file__).parent


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


def texts_of(part):
    """Return the texts of a part and of the modules of hopdata that it imports itself."""
    texts = [part.read_text()]
    for node in ast.walk(ast.parse(texts[0])):
        if isinstance(node, ast.ImportFrom) and node.module:
            room, *below = node.module.split(".")
            file = PACKAGE.joinpath(*below).with_suffix(".py")
            if room == "hopdata" and file.is_file():
                texts.append(file.read_text())
    return texts


def not_given(names, *texts):
    """Return the names that no text of some modules can give."""
    patterns = [re.compile(pattern) for text in texts for pattern in given(text)]
    return {name for name in names if not any(one.fullmatch(name) for one in patterns)}
