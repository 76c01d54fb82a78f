"""The live chain from an item of a link to the snapshot on the pages: pipeline, alarms, prediction, history."""
