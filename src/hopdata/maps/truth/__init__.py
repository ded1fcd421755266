"""What a simulated study is scored against: exact maps, landings, and the scaling study."""
