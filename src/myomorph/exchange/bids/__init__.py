"""Files of the Brain Imaging Data Structure: motion, EMG, and events of a recording."""
