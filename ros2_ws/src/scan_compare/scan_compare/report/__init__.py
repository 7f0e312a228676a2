"""Pictures, tables and one offline page for each comparison."""
