"""What a certificate is made of: each property of models and of tables, with a bound on the error of its residual."""
