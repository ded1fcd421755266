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
    """Return the names that a module can give, its texts and keywords, and patterns.

    A text with values in braces may give any name that it can become: its pattern.
    """
    names = set()
    patterns = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            names.add(node.value)
        elif isinstance(node, ast.keyword) and node.arg:
            names.add(node.arg)
        elif isinstance(node, ast.JoinedStr):
            parts = []
            for part in node.values:
                is_text = isinstance(part, ast.Constant)
                parts.append(re.escape(part.value) if is_text else r"\w+")
            patterns.add("".join(parts))
    return names, patterns


def texts_of(part):
    """Return the texts of a part and of the modules of hopdata that it imports itself."""
    texts = [part.read_text()]
    for node in ast.walk(ast.parse(texts[0])):
        if isinstance(node, ast.ImportFrom) and node.module:
            room, *below = node.module.split(".")
            place = PACKAGE.joinpath(*below)
            modules = [place, *(place / one.name for one in node.names)]
            files = [module.with_suffix(".py") for module in modules]
            if room == "hopdata":
                texts += [file.read_text() for file in files if file.is_file()]
    return texts


def not_given(names, *texts):
    """Return the names that no text of some modules can give."""
    modules = [given(text) for text in texts]
    left = set(names).difference(*(plain for plain, _ in modules))
    # Patterns are slow, and few names need them.
    patterns = [re.compile(one) for _, several in modules if left for one in several]
    return {name for name in left if not any(one.fullmatch(name) for one in patterns)}
