
/* Copies the used outputs, scaled to about 1. Returns whether all are finite. */
static int palpate_used(const float *outputs, float used[USED])
{
    int unit;
    for (unit = 0; unit < USED; unit++) {
        used[unit] = SCALE * outputs[KEPT[unit]];
        if (!isfinite(used[unit])) return 0;
    }
    return 1;
}

/* Whether a reading may be one without a contact. */
static int palpate_is_weak(const float used[USED])
{
    float sum = 0.0f;
    int unit;
    for (unit = 0; unit < USED; unit++) sum += used[unit] * used[unit] / SILENCE[unit];
    return sum < NO_CONTACT;
}
