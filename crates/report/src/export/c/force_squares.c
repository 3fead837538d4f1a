
/* Force of a point, from all outputs by least squares. */
static float palpate_force_n(const float used[USED], int point)
{
    float projected = 0.0f, length = 0.0f;
    int unit;
    for (unit = 0; unit < USED; unit++) {
        projected += used[unit] * ROWS[point][unit];
        length += ROWS[point][unit] * ROWS[point][unit];
    }
    return projected / length * FORCES_N[point];
}
