"""Sessions from elsewhere: fetched from another recorder, imported from other systems, gaps filled."""
