from hopdata.report.rendering import TEMPLATES
from hopdata.report.table import PROSE, Table


def test_a_column_of_long_texts_is_prose():
    rows = (("a", "b" * (PROSE + 1), "1", "mm"), ("c", "d", "2", "s"))
    table = Table("t", ("name", "remark", "value", "unit"), rows, text_columns=2)
    assert [table.kind(i) for i in range(4)] == ["text", "prose", "number", "unit"]


def test_the_style_knows_every_kind_that_it_must_treat_apart():
    style = (TEMPLATES / "report.css").read_text()
    assert "color-scheme: only light;" in style  # else browsers darken the figures' paper
    for kind in (".prose", ".number", ".unit"):
        assert kind in style
