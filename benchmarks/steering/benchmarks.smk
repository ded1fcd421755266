# The benchmarks of steering, beside those of `workflow/rules/benchmarks.smk`, which includes this file.
BENCHMARK_TABLES |= {
    "steering/frame_change_models": [
        "frame_change_models.csv",
        "frame_change_learning.csv",
        "frame_change_kernels.csv",
        "frame_change_cost.csv",
    ],
    "steering/pose": ["pose.csv", "pose_stances.csv", "pose_live.csv", "pose_time.csv"],
    "steering/adaptation": ["adaptation.csv", "adaptation_return.csv"],
    "steering/worlds": ["worlds.csv", "worlds_models.csv"],
    "steering/live_loop": ["live_loop.csv", "live_faults.csv"],
    "steering/robots": ["robots.csv"],
    "steering/live_robots": ["live_robots.csv"],
    "steering/forecasts": ["forecasts.csv"],
    "steering/environment_speed": ["environment_speed.csv"],
}
BENCHMARK_ARGUMENTS |= {
    "steering/adaptation": "--seeds 1",
    "steering/environment_speed": "--strides 2000 --hops 200",
    "steering/forecasts": "--seeds 2",
    "steering/frame_change_models": "--recordings 4 --draws 3",
    "steering/live_loop": "--seconds 15 --hops 300",
    "steering/live_robots": "--seeds 1",
    "steering/pose": "--hops 125 --frames 12000",
    "steering/robots": "--seeds 1",
    "steering/worlds": "--seeds 1 --controllers planner 'planner, last step'",
}
UNTIMED |= {
    "steering/adaptation",
    "steering/forecasts",
    "steering/frame_change_models",
    "steering/live_robots",
    "steering/pose",
    "steering/robots",
    "steering/worlds",
}
# Drawn by `steering_figures.py`.
BENCHMARK_FIGURES |= {
    "steering/learning_curve": ["frame_change_learning.csv"],
    "steering/kernel_smoothness": ["frame_change_kernels.csv"],
    "steering/adaptation": ["adaptation_return.csv"],
    "steering/worlds": ["worlds.csv"],
}
