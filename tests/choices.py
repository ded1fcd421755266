"""The choices by name in a schema, by their path."""

from itertools import combinations


def enumerations(schema, path=()):
    """Yield path and choices of each key of a schema that takes names from a table."""
    if "enum" in schema:
        yield ".".join(path), schema["enum"]
    for key, inner in schema.get("properties", {}).items():
        yield from enumerations(inner, (*path, key))
    if "items" in schema:
        yield from enumerations(schema["items"], path)


def lists_of_choices(schema, path=()):
    """Yield path and choices of each list whose entries are names from a table."""
    if schema.get("type") == "array" and "enum" in schema.get("items", {}):
        yield ".".join(path), tuple(schema["items"]["enum"])
    for key, inner in schema.get("properties", {}).items():
        yield from lists_of_choices(inner, (*path, key))
    if "items" in schema:
        yield from lists_of_choices(schema["items"], path)


def subsets(choices):
    """Return all subsets that are not empty."""
    return [some for k in range(len(choices)) for some in combinations(choices, k + 1)]


def without_products(schema):
    """Return a schema without the blocks of products, which have tests of their own."""
    from hopdata.products import installed

    own = {product.name for product in installed()}
    blocks = schema["properties"].items()
    return {**schema, "properties": {key: one for key, one in blocks if key not in own}}
