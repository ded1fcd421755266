"""The blocks `contacts` and `forces` with the defaults of the schema."""

from hopdata.config.schema import load_schema


def block(name, **given):
    properties = load_schema()["properties"]["recordings"]["items"]["properties"]
    defaults = {
        key: value["default"] for key, value in properties[name]["properties"].items()
    }
    unknown = set(given) - set(defaults)
    assert not unknown, unknown
    return {**defaults, **given}


def columns(**feet_of):
    return [{"name": name, "feet": list(feet)} for name, feet in feet_of.items()]
