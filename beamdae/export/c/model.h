/* Constants of the exported model, defined in model.c. */

#ifndef BEAMDAE_MODEL_H
#define BEAMDAE_MODEL_H

#include "stepper.h"

extern const Model model;
/* GUID or instantiation token of the model description. */
extern const char model_token[];

#endif
