//! From a recipe to files: the only module that knows all stages.
