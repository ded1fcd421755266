"""Write the page of the benchmarks' figures, each above its caption."""

from pathlib import Path

from hopdata.jobs import reported, whole_file
from hopdata.report.inputs import render_caption

with reported(snakemake.log[0]):
    parts = []
    for figure, text in zip(snakemake.input.figures, snakemake.input.captions, strict=True):
        caption = render_caption(Path(text).read_text(), {}, name=Path(figure).stem)
        picture = f"![{caption.alt}]({Path(figure).name})"
        parts += [f"# {caption.title}", picture, *caption.paragraphs]
    with whole_file(snakemake.output[0]) as file:
        file.write_text("\n\n".join(parts) + "\n", encoding="utf-8")
