"""From one item off a link to the snapshot that the pages show: pipeline, alarms, prediction, history."""
