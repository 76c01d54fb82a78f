"""A recorded session, looked back on: reads the file, asks `app.analysis`, keeps what people settle."""
