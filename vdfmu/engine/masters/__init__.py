"""The master: the exchange of values between components, and one file for each way to step them."""
