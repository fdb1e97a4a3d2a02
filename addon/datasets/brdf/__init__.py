"""What the readers of uniform BRDFs share; they are beside this folder, one file each."""
