"""Seeded damage that knows the formats, and files that no program would write.

`damaged` changes a sound input; `HOSTILE` has, for each door, makers of inputs that are
hostile as a whole. All draw from the generator that they are given.
"""

import io
import json
import struct
import zipfile
import zlib
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import damage
import h5py
import numpy as np
import vendor_files
from qtm_files import NAMES, qtm_text, standing
from trc_files import trc_text

TEXTS = (*damage.TEXTS, ".yaml", ".xml")
PACKED = (".zip", ".xlsx", ".npz")
HUGE = 400_000  # of marks, levels or cells: some 100 kB to some MB of a file

# What stands in place of a name.
NAMES_OF_EVIL = (
    "\x1b[31mred\x1b[0m",
    "\x1b]0;title\x07",
    "\u202egnp.exe",
    "\u2066a\u2069",
    "a\u2028b",
    "a\u0085b",
    "a\rb",
    "a\x00b",
    "\ufeff",
    "\ud7ff\U0010ffff",
    "../../../tmp/x",
    "/dev/stdin",
    "CON",
    "=cmd|' /C calc'!A0",
    "<script>alert(1)</script>",
    "{0.__class__}",
    "%n%n%s",
    "a" * 5000,
    "e\u0301",
    "\u0661\u0662",
    "",
    " ",
    "'",
    '"',
)
# What stands in place of a number.
NUMBERS = (
    *("0", "-0", "-1", "1", "2", "nan", "-inf", "inf", "1e308", "-1e308", "1e-320"),
    *("1e-300", "4294967296", "2147483648", "65536", "18446744073709551616", "1e9"),
    *("9" * 400, "1" + "0" * 5000, "0.0000001", "1_0", "0x7f", "1e", "--1", "1;5"),
    *("\u0661", "\uff11\uff12", "NULL", "true", "1+1j", "1e99999", "12:00", "null"),
)
NUMBER = b"0123456789+-.eE"
INTEGERS = (*damage.NUMBERS, 3, 64, 256, 4096, 2**16, 2**24, 2**40, 2**53, 2**62)
FLOATS = (np.nan, np.inf, -np.inf, 0.0, -1.0, 1e38, 1e300, 5e-324, -1e-30, 1e9)


def drawn(choices, rng):
    """Return one of the choices."""
    return choices[int(rng.integers(len(choices)))]


def damaged(name, data, rng):
    """Return a sound input after one damage, or two or three in succession."""
    suffix = Path(name).suffix
    if suffix in PACKED and rng.random() < 0.7:
        return in_archive(data, rng)
    if suffix == ".mat" and rng.random() < 0.4 and not _is_hdf5(data):
        data = in_element(data, rng)
    kinds = IN_BYTES
    if suffix in TEXTS:
        kinds = IN_TEXT
    elif suffix == ".c3d":
        kinds = (*IN_BYTES, in_c3d_record, in_c3d_record, in_c3d_record, in_c3d_header)
    elif suffix == ".packets":
        kinds = (*IN_BYTES, in_word, in_word, in_word)
    for _ in range(int(drawn((1, 1, 1, 2, 3), rng))):
        data = drawn(kinds, rng)(data, rng)
    return data


def _is_hdf5(data):
    return b"\x89HDF\r\n" in data[:1024]


# Damage to bytes.


def in_word(data, rng):
    """Put a number where an aligned number stands, mostly near the beginning."""
    width = int(drawn((2, 4, 4, 8), rng))
    most = min(len(data), int(drawn((64, 600, 4000, 1 << 30), rng)))
    at = int(rng.integers(max(1, most))) // width * width
    order = drawn("<<<>", rng)
    if rng.random() < 0.3 and width > 2:
        with np.errstate(over="ignore", under="ignore"):
            number = np.array(drawn(FLOATS, rng), f"{order}f{width}").tobytes()
    else:
        number = (drawn(INTEGERS, rng) % 256**width).to_bytes(
            width, "little" if order == "<" else "big"
        )
    return data[:at] + number + data[at + width :]


def scaled_word(data, rng):
    """Multiply or divide an aligned number by a power of two, as a count that lies."""
    width = int(drawn((2, 4), rng))
    at = int(rng.integers(max(1, min(len(data), 4000)))) // width * width
    number = int.from_bytes(data[at : at + width], "little")
    power = int(rng.integers(1, 8 * width))
    number = number << power if rng.random() < 0.5 else number >> power
    return (
        data[:at] + (number % 256**width).to_bytes(width, "little") + data[at + width :]
    )


def swapped(data, rng):
    """Exchange two pieces."""
    if len(data) < 8:
        return data
    a, b, c = sorted(int(k) for k in rng.integers(len(data), size=3))
    return data[:a] + data[b:c] + data[a:b] + data[c:]


def turned_bytes(data, rng):
    """Turn the bytes of a run of numbers round, as with the other order of bytes."""
    width = int(drawn((2, 4, 8), rng))
    at = int(rng.integers(max(1, len(data)))) // width * width
    length = width * int(rng.integers(1, 60))
    piece = data[at : at + length]
    piece = piece[: len(piece) // width * width]
    turned = np.frombuffer(piece, np.uint8).reshape(-1, width)[:, ::-1].tobytes()
    return data[:at] + turned + data[at + len(piece) :]


IN_BYTES = (
    *(damage.flip, damage.truncate, damage.extend, damage.delete, damage.repeat),
    *(damage.lie, in_word, in_word, scaled_word, swapped, turned_bytes),
)


# Damage to text.


def _words(data):
    """Return the places of the words of a text: begin, end and whether it is a number."""
    found, at = [], 0
    for piece in _split(data):
        if piece.strip():
            lead = len(piece) - len(piece.lstrip())
            word = piece.strip()
            is_number = all(c in NUMBER for c in word) and any(
                48 <= c < 58 for c in word
            )
            found.append((at + lead, at + lead + len(word), is_number))
        at += len(piece) + 1
    return found


def _split(data):
    for mark in b',;=<>[]{}()":\n':
        data = data.replace(bytes([mark]), b"\t")
    return data.split(b"\t")


def in_words(data, rng):
    """Put a number in place of numbers, or a name in place of names."""
    words = _words(data)
    if not words:
        return data
    early = words[: max(1, int(len(words) * drawn((0.03, 0.2, 1.0), rng)))]
    begin, end, is_number = drawn(early, rng)
    evil = drawn(NUMBERS if is_number else NAMES_OF_EVIL, rng)
    if rng.random() < 0.1:
        evil = drawn(NAMES_OF_EVIL if is_number else NUMBERS, rng)
    return data[:begin] + evil.encode("utf-8", "surrogatepass") + data[end:]


def same_words(data, rng):
    """Put one word in place of another, so that names or keys stand twice."""
    words = [one for one in _words(data) if not one[2]]
    if len(words) < 2:
        return data
    begin, end, _ = drawn(words, rng)
    other = drawn(words, rng)
    return data[:begin] + data[other[0] : other[1]] + data[end:]


def at_border(data, rng):
    """Cut the text behind a word."""
    words = _words(data)
    if not words:
        return data
    begin, end, _ = drawn(words, rng)
    return data[: begin if rng.random() < 0.5 else end]


def in_column(data, rng):
    """Put a number in place of a whole column."""
    lines = data.split(b"\n")
    mark = max((b"\t", b",", b" "), key=data.count)
    most = max(line.count(mark) for line in lines)
    column = int(rng.integers(max(1, most)))
    evil = drawn(NUMBERS, rng).encode()
    first = int(rng.integers(min(len(lines), 14)))
    for k in range(first, len(lines)):
        fields = lines[k].split(mark)
        if len(fields) > column + 1:
            fields[column] = evil
            lines[k] = mark.join(fields)
    return b"\n".join(lines)


def less_or_more_columns(data, rng):
    """Leave a column out, or put one twice, in all rows or from one on."""
    lines = data.split(b"\n")
    mark = max((b"\t", b","), key=data.count)
    column = int(rng.integers(1 + max(line.count(mark) for line in lines)))
    first = int(rng.integers(len(lines)))
    twice = rng.random() < 0.5
    for k in range(first, len(lines)):
        fields = lines[k].split(mark)
        if len(fields) > column:
            fields[column : column + 1] = [fields[column]] * (2 if twice else 0)
            lines[k] = mark.join(fields)
    return b"\n".join(lines)


def other_encoding(data, rng):
    """Write the text in another encoding, or say that it is in another."""
    kind = drawn(("utf-16", "utf-16-be", "utf-32", "utf-8-sig", "lie", "cp037"), rng)
    if kind == "lie":
        return drawn((b"\xff\xfe", b"\xfe\xff", b"\xef\xbb\xbf", b"\x00"), rng) + data
    return data.decode("latin-1").encode(kind, "replace")


def other_line_ends(data, rng):
    end = drawn((b"\r", b"\r\r\n", b"\n\r", b"\x0b", b"\x85", b"", b"\n\n\n"), rng)
    return data.replace(b"\r\n", b"\n").replace(b"\n", end)


def nested(data, rng):
    """Put many opening marks somewhere."""
    opening = drawn((b"[", b"{", b'{"a":', b"<a>", b"(", b"- ", b'"', b"&a ["), rng)
    at = damage._place(data, rng)
    return data[:at] + opening * int(drawn((50, 1000, 20_000), rng)) + data[at:]


IN_TEXT = (
    *(damage.flip, damage.truncate, damage.delete, damage.repeat, damage.move_line),
    *(damage.lie_in_words, in_words, in_words, in_words, same_words, at_border),
    *(
        in_column,
        less_or_more_columns,
        other_encoding,
        other_line_ends,
        nested,
        swapped,
    ),
)


# Damage to a record of C3D's parameters, and to its header.


def _c3d_records(data):
    """Return the places of the parameters' records: the name, type, sizes and data."""
    at = 512 * max(0, data[0] - 1) + 4
    places = []
    while at + 2 < len(data) and len(places) < 300:
        length = data[at] - 256 * (data[at] > 127)
        if not length:
            break
        behind = at + 2 + abs(length)
        offset = int.from_bytes(data[behind : behind + 2], "little")
        places.append((at, behind))
        if not offset:
            break
        at = behind + offset
    return places


def in_c3d_record(data, rng):
    """Change the length, group, name, type, sizes or data of a record."""
    places = _c3d_records(data)
    if not places:
        return data
    at, behind = drawn(places, rng)
    places_of_record = [at, at + 1, at + 2, behind, behind + 1, behind + 2]
    places_of_record += [behind + 3 + k for k in range(int(rng.integers(1, 12)))]
    place = drawn(places_of_record, rng)
    value = int(drawn((0, 1, 2, 3, 4, 8, 127, 128, 129, 252, 253, 255), rng))
    changed = bytearray(data)
    if place < len(changed):
        changed[place] = value
    return bytes(changed)


def in_c3d_header(data, rng):
    """Change one of the words of the header that tell counts and places."""
    word = int(drawn((0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 147, 148, 149, 150), rng))
    number = drawn(INTEGERS, rng) % 65536
    return data[: 2 * word] + struct.pack("<H", number) + data[2 * word + 2 :]


# Damage inside packed data.


def in_archive(data, rng):
    """Damage a member before it is packed, or what the archive says of its members."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = {one: archive.read(one) for one in archive.namelist()}
    except (zipfile.BadZipFile, KeyError):
        return damage.flip(data, rng)
    name = drawn([*members], rng)
    if rng.random() < 0.2:
        return _archive_that_lies(members, name, rng)
    kinds = IN_TEXT
    if name.endswith(".npy"):
        kinds = (in_npy_header, in_npy_header, in_word, damage.truncate)
    for _ in range(int(rng.integers(1, 3))):
        members[name] = drawn(kinds, rng)(members[name], rng)
    return zipped(members)


def zipped(members):
    """Pack members, always to the same bytes."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_DEFLATED)
    return file.getvalue()


def _archive_that_lies(members, name, rng):
    kind = int(rng.integers(5))
    content = members.pop(name)
    if kind == 0:
        return zipped(members)  # a member is missing
    if kind == 1:
        return zipped({**members, f"../../{name}": content, "/x": b"x"})
    if kind == 2:
        return zipped({**members, name: bytes(HUGE * 200)})
    packed = zipped({**members, name: content})
    field = drawn((b"PK\x01\x02", b"PK\x03\x04", b"PK\x05\x06"), rng)
    at = packed.rfind(field)
    at += int(rng.integers(4, 46))
    width = int(drawn((2, 4), rng))
    number = (drawn(INTEGERS, rng) % 256**width).to_bytes(width, "little")
    return packed[:at] + number + packed[at + width :]


def in_npy_header(data, rng):
    """Change the kind, order or shape that an array states."""
    evil = drawn(
        (
            (b"'<f8'", b"'|O'"),
            (b"'<f8'", b"'<U99999999'"),
            (b"'<f8'", b"'<c16'"),
            (b"'<f8'", b"'>f8'"),
            (b"'<f8'", b"[('a','<f8')]"),
            (b"'<f8'", b"'<M8[s]'"),
            (b"False", b"True"),
            (b"(", b"(4000000000, "),
            (b"(", b"(-1, "),
            (b"(", b"(0, "),
            (b"(", b"(" * 200),
            (b"3", b"30000000"),
            (b"NUMPY\x01", b"NUMPY\x09"),
        ),
        rng,
    )
    return data.replace(*evil, 1)


def in_element(data, rng):
    """Damage an element of a MAT file, before it is compressed if it was."""
    head, at, elements = data[:128], 128, []
    while at + 8 <= len(data):
        kind, size = struct.unpack_from("<II", data, at)
        elements.append((kind, data[at + 8 : at + 8 + size]))
        at += 8 + size
    out = head
    chosen = int(rng.integers(max(1, len(elements))))
    for k, (kind, content) in enumerate(elements):
        if kind == 15:
            content = _inflated(content)
        if k == chosen:
            for _ in range(int(rng.integers(1, 3))):
                content = drawn((in_word, in_word, scaled_word, damage.flip), rng)(
                    content, rng
                )
        if kind == 15:
            content = zlib.compress(content)
        out += struct.pack("<II", kind, len(content)) + content
    return out


def _inflated(content):
    try:
        return zlib.decompress(content)
    except zlib.error:
        return content


# Hostile text.


def _rows(rng, heads, mark, n_rows=5):
    rows = [mark.join([str(k)] * len(heads)) for k in range(n_rows)]
    return (mark.join(heads) + "\n" + "\n".join(rows) + "\n").encode()


def many_columns(rng):
    mark = drawn("\t,", rng)
    n = int(drawn((1000, 30_000, 150_000), rng))
    heads = ["Time", *(f"m{k // 3}{'XYZ'[k % 3]}" for k in range(n))]
    return drawn(("a.tsv", "a.csv", "a.txt"), rng), _rows(rng, heads, mark, 2)


def same_columns(rng):
    heads = ["Time", *["aX", "aY", "aZ"] * int(drawn((2, 300, 30_000), rng))]
    return drawn(("a.csv", "a.txt"), rng), _rows(rng, heads, drawn("\t,", rng), 2)


def one_line(rng):
    begin = drawn(
        (b"NO_OF_FRAMES\t1\n", b"", b"Time\taX\taY\taZ\n", b"PathFileType\t4\n"), rng
    )
    name = drawn(("a.tsv", "a.csv", "a.trc", "a.txt"), rng)
    return name, begin + drawn((b"a\t", b"1,", b'"', b"\0", b" "), rng) * HUGE * 5


def many_names(rng):
    n = int(drawn((300, 21_000, 100_000), rng))
    text = qtm_text(standing(2), names=NAMES).split("MARKER_NAMES")[0]
    text += "MARKER_NAMES\t" + "\t".join("a" * n) + "\n" + "\t".join("1" * 3 * n) + "\n"
    return "a.tsv", text.replace("NO_OF_MARKERS\t5", f"NO_OF_MARKERS\t{n}").encode()


def evil_names(rng):
    """Return a sound table whose markers have evil names."""
    names = [drawn(NAMES_OF_EVIL, rng) for _ in NAMES]
    positions = standing(24)
    if rng.random() < 0.5:
        return "a.tsv", qtm_text(positions, names=names).encode(
            "utf-8", "surrogatepass"
        )
    return "a.trc", trc_text(positions, names).encode("utf-8", "surrogatepass")


def evil_times(rng):
    """Return a table whose times repeat, run backwards, or are no numbers."""
    steps = drawn((0.0, -0.01, 1e-300, 1e300, np.nan, np.inf, 5e-324, 1e6), rng)
    with np.errstate(over="ignore", invalid="ignore"):
        time = np.arange(24) * steps
    heads = ["Time", *(f"{name}_{a}" for name in NAMES for a in "xyz")]
    rows = [
        ",".join(map(str, [t, *row.ravel()]))
        for t, row in zip(time, standing(24), strict=True)
    ]
    return "a.csv", (",".join(heads) + "\n" + "\n".join(rows) + "\n").encode()


def evil_rate(rng):
    rate = drawn(NUMBERS, rng)
    if rng.random() < 0.5:
        return "a.tsv", qtm_text(standing(24), frequency=rate).encode()
    return "a.trc", trc_text(standing(24), NAMES).replace("100", rate, 1).encode()


def evil_counts(rng):
    key = drawn(("NO_OF_FRAMES", "NO_OF_MARKERS", "NO_OF_CAMERAS", "NO_OF_ANALOG"), rng)
    return "a.tsv", qtm_text(standing(24), header={key: drawn(NUMBERS, rng)}).encode()


# Hostile trees: JSON, YAML and XML.


def deep_json(rng):
    opening, closing = drawn((("[", "]"), ('{"a":', "}")), rng)
    n = int(drawn((100, 5000, HUGE), rng))
    return (opening * n + "1" + closing * n).encode()


def wide_json(rng):
    n = int(drawn((1000, HUGE // 2), rng))
    return ("{" + ",".join(f'"k{k}":{k}' for k in range(n)) + "}").encode()


def odd_json(rng):
    return drawn(
        (
            b"",
            b"null",
            b"[]",
            b"NaN",
            b'"\\ud800"',
            b"1" * 5000,
            b'{"a":1,"a":2}',
            b"\xff\xfe{\x00}\x00",
            b"[1e999]",
            b'{"\\u001b[31m":"\\u202e"}',
        ),
        rng,
    )


def yaml_bomb(rng):
    """Return aliases that expand without limit, or a tree within itself."""
    if rng.random() < 0.3:
        return b"study: x\nx: &a [*a, *a]\nmarkers: &m {body: *m}\n"
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    for k in range(int(drawn((4, 9, 30), rng))):
        lines.append(f"a{k + 1}: &a{k + 1} [{', '.join([f'*a{k}'] * 9)}]")
    return ("\n".join(lines) + "\n").encode()


def yaml_tags(rng):
    """Return a value with a tag that its text does not fit, or that makes objects."""
    tag = drawn(
        (
            *(
                "!!timestamp",
                "!!binary",
                "!!set",
                "!!omap",
                "!!pairs",
                "!!int",
                "!!float",
            ),
            *("!!python/object/apply:os.system", "!!python/name:os.system", "!!null"),
            *("!!bool", "!!merge", "!x", "!!map", "!!seq", "!!str", "!<tag:x>"),
        ),
        rng,
    )
    value = drawn(
        ("x", "[x]", "{a: x}", "''", "2020-99-99", "0x", "!!int 1", "[[a]]"), rng
    )
    key = drawn(("study", "seed", "markers", "recordings", "input", "x"), rng)
    return (
        f"study: x\nmarkers: {{body: [a], feet: [b]}}\n{key}: {tag} {value}\n".encode()
    )


def yaml_values(rng):
    """Return a configuration whose keys have values of any kind."""
    keys = ("study", "seed", "recordings", "markers", "input", "verdict", "figures")
    keys += (
        "simulation",
        "home",
        "report",
        "sections",
        "printed",
        "steering",
        "dissertation",
    )
    lines = []
    for key in keys:
        if rng.random() < 0.6:
            lines.append(f"{key}: {_value(rng)}")
    return ("\n".join(lines) + "\n").encode("utf-8", "surrogatepass")


def _value(rng, depth=0):
    kind = int(rng.integers(9))
    if kind == 0 and depth < 3:
        return "[" + ", ".join(_value(rng, depth + 1) for _ in range(3)) + "]"
    if kind == 1 and depth < 3:
        keys = (
            "name",
            "file",
            "body",
            "feet",
            "unit",
            "rate_hz",
            "scene",
            "1",
            "~",
            "[a]",
        )
        pairs = [f"{drawn(keys, rng)}: {_value(rng, depth + 1)}" for _ in range(3)]
        return "{" + ", ".join(pairs) + "}"
    if kind < 4:
        return drawn(
            ("0", "-1", ".nan", ".inf", "1e400", "9" * 30, "0o7", "1:30", "~"), rng
        )
    if kind < 6:
        return json.dumps(drawn(NAMES_OF_EVIL, rng))
    return drawn(("yes", "2020-01-01", "!!binary aGk=", "<<", "a", "''", "?", "|"), rng)


XML_BOMB = """<?xml version="1.0"?>
<!DOCTYPE x [<!ENTITY a0 "aaaaaaaaaaaaaaaaaaaa">{entities}]>
<mvnx><subject label="&a{n};"/></mvnx>
"""


def xml_bomb(rng):
    """Return entities that expand without limit, or that name a file."""
    if rng.random() < 0.3:
        return b'<!DOCTYPE x [<!ENTITY e SYSTEM "file:///etc/passwd">]><mvnx>&e;</mvnx>'
    n = int(drawn((2, 12), rng))
    entities = "".join(f'<!ENTITY a{k + 1} "{f"&a{k};" * 10}">' for k in range(n))
    return XML_BOMB.format(entities=entities, n=n).encode()


def deep_xml(rng):
    n = int(drawn((500, 20_000, HUGE // 2), rng))
    return b"<a>" * n + b"</a>" * (n if rng.random() < 0.5 else 0)


def wide_xml(rng):
    n = int(drawn((1000, HUGE // 8), rng))
    attributes = " ".join(f'a{k}="{k}"' for k in range(n))
    labels = "<Label><Name>a</Name></Label>" * n
    return f"<QTM {attributes}><The_3D>{labels}</The_3D></QTM>".encode()


def table_of_evil(rng):
    """Return a table of samples with evil names, cells, lines and columns."""
    columns = ["subject", "file", "condition", "session", "recording", "mass"]
    used = [one for one in columns if one in ("subject", "file") or rng.random() < 0.5]
    lines = ["\t".join(used)]
    for k in range(int(drawn((1, 3, 2000), rng))):
        cells = [
            drawn(NAMES_OF_EVIL, rng) if rng.random() < 0.2 else f"c{k}" for _ in used
        ]
        lines.append("\t".join(cells))
    return "\n".join(lines).encode("utf-8", "surrogatepass")


def long_cell(rng):
    cell = drawn((b"x", b'"', b"\t", b"\\"), rng) * int(
        drawn((5000, 140_000, 3_000_000), rng)
    )
    return b"subject\tfile\ns1\t" + cell + b"\n"


def many_rows(rng):
    n = int(drawn((2000, 40_000), rng))
    return b"subject\tfile\n" + b"".join(b"s%d\tf%d\n" % (k, k) for k in range(n))


# Hostile HDF5.


def _hdf5(fill):
    """Return the bytes of an HDF5 file that a function has filled."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "a.h5")
        with h5py.File(path, "w", track_order=False) as file:
            fill(file)
        return path.read_bytes()


def deep_groups(rng):
    n = int(drawn((40, 900), rng))

    def fill(file):
        file.create_group("tracks")
        group = file
        for _ in range(n):
            group = group.create_group("g")

    return _hdf5(fill)


def many_links(rng):
    n = int(drawn((2000, 25_000), rng))
    kind = int(rng.integers(3))

    def fill(file):
        file.create_group("tracks")
        for k in range(n):
            if kind == 0:
                file[f"l{k}"] = h5py.SoftLink("/tracks")
            elif kind == 1:
                file[f"l{k}"] = h5py.ExternalLink("/dev/zero", "/x")
            else:
                file[f"l{k}"] = file["tracks"]

    return _hdf5(fill)


def links_that_lead_nowhere(rng):
    names = ("tracks", "time", "positions", "markers", "x", "y", "node_names", "roles")
    kind = int(rng.integers(4))

    def fill(file):
        for name in names:
            if kind == 0:
                file[name] = h5py.SoftLink(f"/{name}")
            elif kind == 1:
                file[name] = h5py.ExternalLink("/etc/passwd", "/x")
            elif kind == 2:
                file[name] = h5py.ExternalLink("input.h5", "/tracks")
            else:
                file.create_group(name)[name] = h5py.SoftLink("/")

    return _hdf5(fill)


def huge_datasets(rng):
    """Return datasets that state far more numbers than the file has bytes."""
    shape = drawn(
        ((1 << 33,), (1 << 16, 1 << 16), (24, 5, 1 << 40), (1 << 62,), (0,), ()), rng
    )
    kind = drawn((np.float64, np.float32, np.int8, np.uint64), rng)
    names = ("tracks", "time", "positions", "x", "y", "track_occupancy")

    def fill(file):
        for name in names:
            chunks = (
                tuple(min(one, 1024) for one in shape) if shape and all(shape) else None
            )
            if chunks is not None and np.prod(chunks, dtype=float) > 1 << 20:
                chunks = (1,) * len(shape)
            file.create_dataset(name, shape, kind, chunks=chunks)

    return _hdf5(fill)


def inflated_datasets(rng):
    """Return zeros that were deflated by a thousand."""
    n = int(drawn((1_000_000, 40_000_000), rng))

    def fill(file):
        zeros = np.zeros(n, np.int8)
        file.create_dataset(
            "tracks", data=zeros, compression="gzip", chunks=(min(n, 1 << 20),)
        )
        file["node_names"] = np.array([b"a"])

    return _hdf5(fill)


def odd_types(rng):
    """Return datasets and attributes of kinds that nobody expects."""
    kinds = (
        np.complex128,
        np.float16,
        "S5",
        h5py.string_dtype(),
        h5py.vlen_dtype(np.float64),
        h5py.ref_dtype,
        h5py.regionref_dtype,
        np.dtype([("a", "f8"), ("b", "S3")]),
        h5py.enum_dtype({"A": 1, "B": 2}),
        np.dtype(("f8", (3,))),
        np.dtype("V7"),
        bool,
    )
    names = ("tracks", "time", "positions", "markers", "roles", "node_names", "x", "y")
    attributes = (
        "rate_hz",
        "unit",
        "format",
        "name",
        "body_markers",
        "length_unit_m",
        "setup",
    )
    kinds_of = [drawn(kinds, rng) for _ in names + attributes]
    sizes = [drawn(((), (0,), (3,), (24,), (24, 5, 3), (6, 18)), rng) for _ in names]

    def fill(file):
        for name, kind, size in zip(names, kinds_of, sizes, strict=False):
            file.create_dataset(name, size, kind)
        for name, kind in zip(attributes, kinds_of[len(names) :], strict=True):
            try:
                file.attrs.create(name, np.zeros(2), (2,), kind)
            except (TypeError, ValueError, AttributeError):
                file.attrs[name] = h5py.Empty("f8")

    return _hdf5(fill)


def names_in_hdf5(rng):
    evil = [drawn(NAMES_OF_EVIL, rng).replace("\0", "") or "a" for _ in NAMES]

    def fill(file):
        file["tracks"] = np.moveaxis(standing(24)[None], 0, 1)
        text = h5py.string_dtype()
        file.create_dataset("node_names", data=np.array(evil, object), dtype=text)
        file.attrs["\x1b[31m"] = "\x1b[0m"

    return _hdf5(fill)


@cache
def _pickled():
    """Return a table of pandas whose names are pickled."""
    return damage.corpus()["rows.h5"]


def pickle_that_acts(rng):
    """Return a table of keypoints whose pickled names would run a program."""
    evil = drawn(
        (
            b"cos\nsystem\n(S'touch RAN'\ntR.",
            b"cbuiltins\neval\n(S'1/0'\ntR.",
            b"(lp0\n" + b"(" * 5000 + b".",
            b"\x80\x04\x95\xff\xff\xff\xff\xff\xff\xff\xff.",
            b"\x80\x02]r\x80\xd1\xf0\x08.",
            b"I" + b"9" * 50_000 + b"\n.",
            b"\x80\x02" + b"]q\x00" * 200 + b"e" * 200 + b".",
        ),
        rng,
    )
    sound = _pickled()
    at = sound.find(b"(lp")
    if at < 0:
        at = sound.find(b"\x80\x02")
    if at < 0:
        return sound
    return sound[:at] + evil + sound[at + len(evil) :]


# Hostile archives, arrays and models.


def bomb_in_archive(rng):
    n = int(drawn((1 << 22, 1 << 28), rng))
    name = drawn(
        ("data.json", "metadata.json", "xl/worksheets/sheet1.xml", "inputs.npy"), rng
    )
    return zipped({"metadata.json": b"{}", name: bytes(n)})


def many_members(rng):
    n = int(drawn((500, 20_000), rng))
    return zipped({f"m{k}.npy": b"" for k in range(n)})


def models_of_odd_arrays(rng):
    names = ("smoothness", "periodic", "inputs", "outputs", "offset", "unit")
    names += ("variance", "noise", "length_scales")
    shapes = {"inputs": (9, 2), "outputs": (9, 3), "length_scales": (3, 2)}
    arrays = {}
    for name in names:
        shape = shapes.get(name, () if name in ("smoothness", "periodic") else (3,))
        kind = drawn(("f8", "f8", "f8", "c16", "S4", "U3", "M8[s]", "i1", "?"), rng)
        with np.errstate(invalid="ignore"):
            value = np.full(shape, drawn((*FLOATS, 1.5), rng))
            arrays[name] = (
                value.astype(kind) if kind != "M8[s]" else np.zeros(shape, kind)
            )
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


# Hostile MAT files, C3D files and packets.


def deep_mat(rng):
    """Return structs within structs, whose sizes fit."""
    content = _mat_matrix(b"")
    for _ in range(int(drawn((20, 400, 3000), rng))):
        content = _mat_matrix(content)
    return b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM" + content


def _mat_matrix(inner):
    flags = struct.pack("<IIII", 6, 8, 1, 0)  # a cell
    sizes = struct.pack("<IIii", 5, 8, 1, 1 if inner else 0)
    name = struct.pack("<II", 0x00010001, ord("q"))
    body = flags + sizes + name + inner
    return struct.pack("<II", 14, len(body)) + body


def many_matrices(rng):
    n = int(drawn((2000, 120_000), rng))
    return b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM" + _mat_matrix(b"") * n


def mat_bomb(rng):
    n = int(drawn((1 << 20, 1 << 27), rng))
    body = struct.pack("<IIII", 6, 8, 6, 0) + struct.pack("<IIii", 5, 8, n // 8, 1)
    body += (
        struct.pack("<II", 0x00010001, ord("q")) + struct.pack("<II", 9, n) + bytes(n)
    )
    content = zlib.compress(struct.pack("<II", 14, len(body)) + body)
    head = b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM"
    return head + struct.pack("<II", 15, len(content)) + content


def c3d_of_lies(rng):
    """Return a C3D file whose parameters do not fit its data."""
    point = {
        "USED": int(drawn((0, 1, 5, 255, 32767), rng)),
        "FRAMES": int(drawn((0, 1, 24, 65535), rng)),
        "SCALE": np.float32(drawn((-1.0, 0.0, 1e-40, 1e38, np.nan, np.inf, 1.0), rng)),
        "RATE": np.float32(drawn((0.0, -1.0, 100.0, np.nan, np.inf, 1e-40, 1e38), rng)),
        "DATA_START": int(drawn((0, 1, 3, 32767), rng)),
        "UNITS": [drawn(("mm", "", "\x1b[31m", "furlong", "m", "\0\0"), rng)],
    }
    kept = {key: value for key, value in point.items() if rng.random() < 0.4}
    analog = {
        "USED": int(drawn((0, 1, 255, 32767), rng)),
        "RATE": np.float32(drawn((0.0, -100.0, 1e38, np.nan), rng)),
    }
    groups = {"POINT": kept}
    if rng.random() < 0.4:
        groups["ANALOG"] = analog
    names = [
        drawn(NAMES_OF_EVIL, rng).encode("latin-1", "replace").decode("latin-1")[:100]
        for _ in NAMES
    ]
    if rng.random() < 0.6:
        names = list(NAMES)
    processor = drawn(("Intel", "DEC", "MIPS"), rng)
    return vendor_files.c3d(standing(24), names, groups=groups, processor=processor)


def packets_of_lies(rng):
    """Return packets whose parts state other lengths than they have."""
    stream = b""
    for _ in range(int(rng.integers(1, 5))):
        markers = struct.pack(
            "<Ihh", drawn((0, 1, 2, 2**32 - 1), rng), 0, 0
        ) + rng.bytes(24)
        size = drawn((0, 1, 8, 8 + len(markers), 2**32 - 1), rng)
        component = struct.pack("<II", size, drawn((1, 2, 3, 9, 10, 99), rng)) + markers
        frame = struct.pack(
            "<qII", drawn((0, -1, 2**62), rng), 1, drawn((0, 1, 2, 2**32 - 1), rng)
        )
        payload = frame + component
        true_size = 8 + len(payload)
        size = drawn((true_size, true_size, true_size, 0, 8, 2**31, true_size - 1), rng)
        stream += (
            struct.pack("<II", size, drawn((0, 1, 2, 3, 3, 3, 4, 6, 9, 77), rng))
            + payload
        )
    return stream


def noise(rng):
    """Return bytes without a meaning."""
    return rng.bytes(int(drawn((0, 1, 7, 511, 4000), rng)))


def _as(name, maker):
    """Return a maker of a file of this name."""

    def make(rng):
        return name, maker(rng)

    make.__name__ = maker.__name__
    return make


def _all_as(name, *makers):
    return [_as(name, maker) for maker in (*makers, noise)]


_HDF5 = (
    *(deep_groups, many_links, links_that_lead_nowhere, huge_datasets),
    *(inflated_datasets, odd_types, odd_types, odd_types, names_in_hdf5),
)
_TABLES = (
    many_columns,
    same_columns,
    one_line,
    many_names,
    evil_names,
    evil_times,
    evil_rate,
    evil_counts,
)


def _of_suffix(suffix, makers=_TABLES):
    """Return makers of tables, as files of another suffix."""
    return [_as(f"a{suffix}", lambda rng, one=one: one(rng)[1]) for one in makers]


_JSON = (deep_json, wide_json, odd_json)
_ARCHIVES = (bomb_in_archive, many_members)
_YAML = (
    yaml_bomb,
    yaml_tags,
    yaml_tags,
    yaml_values,
    yaml_values,
    yaml_values,
    deep_json,
)

#: Makers of whole hostile inputs (the name and the bytes) by the name of a door.
HOSTILE = {
    "c3d": _all_as("a.c3d", c3d_of_lies, c3d_of_lies, c3d_of_lies),
    "tables": [*_TABLES, *_all_as("a.csv")],
    "trc": [*_of_suffix(".trc", (evil_names, evil_rate, one_line)), *_all_as("a.trc")],
    "trb": _all_as("a.trb"),
    "bvh": _all_as("a.bvh", deep_json, deep_xml),
    "mvnx": _all_as("a.mvnx", xml_bomb, deep_xml, wide_xml),
    "mat": _all_as("a.mat", deep_mat, many_matrices, mat_bomb, *_HDF5),
    "hdf5": _all_as("a.h5", *_HDF5, pickle_that_acts, pickle_that_acts),
    "ktk": _all_as("a.ktk.zip", *_ARCHIVES),
    "xlsx": _all_as("a.xlsx", *_ARCHIVES),
    "bids": _all_as(damage.NAME + "_motion.json", *_JSON),
    "own": _all_as("a.h5", *_HDF5),
    "plates": _all_as("a.c3d", c3d_of_lies),
    "forces": [*_of_suffix(".mot"), *_of_suffix(".csv"), *_all_as("a.txt")],
    "contacts": [*_of_suffix(".csv"), *_all_as("a.tsv", long_cell)],
    "config": _all_as("a.yaml", *_YAML),
    "group": [
        *_all_as("a.tsv", table_of_evil, table_of_evil, long_cell, many_rows),
        *_all_as("a.yaml", *_YAML),
    ],
    "provenance": _all_as("a.json", *_JSON),
    "pairs": _all_as("a.h5", *_HDF5),
    "saved": [*_all_as("a.json", *_JSON), *_of_suffix(".csv")],
    "model": _all_as(
        "a.npz", *_ARCHIVES, models_of_odd_arrays, models_of_odd_arrays, deep_json
    ),
    "log": _all_as("a.h5", *_HDF5),
    "packets": _all_as("a.packets", packets_of_lies, packets_of_lies, packets_of_lies),
    "settings": _all_as("a.xml", xml_bomb, deep_xml, wide_xml),
    "code": _all_as("code.nbi"),
    "plugin": _all_as("a.odd"),
    "inspect": [evil_names, evil_counts, *_all_as("a.c3d", c3d_of_lies)],
}


def case(door_name, sound, seed, number):
    """Return name and bytes of the input `number` of a door.

    One in three is hostile as a whole. The seeds are told by the door and the number, so
    that more doors or more inputs leave the others as they were.
    """
    seeds = np.random.SeedSequence([seed, number, *door_name.encode()])
    rng = np.random.Generator(np.random.PCG64(seeds))
    makers = HOSTILE[door_name]
    if number % 3 == 2:
        return makers[number // 3 % len(makers)](rng)
    name = [*sound][number % len(sound)]
    return name, damaged(name, sound[name], rng)
