"""A figure of the results of a study."""


def spreads_figure(touchdowns):
    """Draw how far apart the contacts of the landings are."""
    from matplotlib.figure import Figure

    figure = Figure()
    axes = figure.subplots()
    axes.hist(1e3 * touchdowns["spread_s"].dropna(), bins=30)
    axes.set_xlabel("from the first contact to the last (ms)")
    axes.set_ylabel("landings")
    return figure


spreads_figure.files = ("tables/touchdowns.csv",)
