// What a segment has passed since it last was among no fibers; see medium/correlated_step.glsl.
struct FiberRun {
    float depth;   // optical depth, as if fibers were independent points
    float fibers;  // how many it has passed through the voxels of
    float own;     // one where the fiber that it left is among them, OWN_PASSED behind it
};

const float OWN_PASSED = -1.0;

const FiberRun NO_FIBERS = FiberRun(0.0, 0.0, 0.0);
