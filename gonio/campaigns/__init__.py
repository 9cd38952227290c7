"""Campaigns: many subjects measured, fitted, checked, reduced and reported, in processes of this or other machines."""
