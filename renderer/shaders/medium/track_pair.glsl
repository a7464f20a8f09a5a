// Flights by one estimator and shadow rays by another: generated/track.glsl defines track_flight and track_shadow before.
void track(inout Path p) {
    if (p.mode == MODE_SHADOW) {
        track_shadow(p);
    } else {
        track_flight(p);
    }
}
