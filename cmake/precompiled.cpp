// The compiler makes the precompiled headers along with this file.
