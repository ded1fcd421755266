"""First-order information: saltation, Bouligand derivatives, and what they say of smoothness."""
