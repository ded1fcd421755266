rule close_landings:
    """List the landings whose contacts are close together."""
    input:
        touchdowns=f"{RESULTS}/tables/touchdowns.csv",
    output:
        table=f"{RESULTS}/tables/close_landings.csv",
    log:
        f"{RESULTS}/logs/close_landings.log",
    params:
        at_most_ms=STUDY["close_landings"]["at_most_ms"],
    script:
        "scripts/close_landings.py"
