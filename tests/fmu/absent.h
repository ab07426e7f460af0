/* Functions that have to be there and are not called, and NONE, FINE, FREE, MAKE, which write such. */
#define NONE(name) int name(void) { return 3; }
#define FINE(name) int name(void *c) { return 0; }
#define FREE(name) void name(void *c) { free(c); }
#define MAKE(name) void *name(void) { return make(); }

#if !DIRECTIONAL
NONE(fmi2GetDirectionalDerivative)
NONE(fmi3GetDirectionalDerivative)
#endif
NONE(fmi2CancelStep) NONE(fmi2CompletedIntegratorStep) NONE(fmi2DeSerializeFMUstate) NONE(fmi2DoStep)
NONE(fmi2FreeFMUstate) NONE(fmi2GetBoolean) NONE(fmi2GetBooleanStatus) NONE(fmi2GetContinuousStates)
NONE(fmi2GetDerivatives) NONE(fmi2GetEventIndicators) NONE(fmi2GetFMUstate) NONE(fmi2GetInteger)
NONE(fmi2GetIntegerStatus) NONE(fmi2GetNominalsOfContinuousStates) NONE(fmi2GetRealOutputDerivatives)
NONE(fmi2GetRealStatus) NONE(fmi2GetStatus) NONE(fmi2GetString) NONE(fmi2GetStringStatus) NONE(fmi2Reset)
NONE(fmi2SerializeFMUstate) NONE(fmi2SerializedFMUstateSize) NONE(fmi2SetBoolean) NONE(fmi2SetDebugLogging)
NONE(fmi2SetFMUstate) NONE(fmi2SetInteger) NONE(fmi2SetRealInputDerivatives) NONE(fmi2SetString)
NONE(fmi2SetTime) NONE(fmi2Terminate) NONE(fmi3ActivateModelPartition) NONE(fmi3CompletedIntegratorStep)
NONE(fmi3DeserializeFMUState) NONE(fmi3DoStep) NONE(fmi3EnterStepMode)
NONE(fmi3EvaluateDiscreteStates) NONE(fmi3FreeFMUState)
NONE(fmi3GetAdjointDerivative) NONE(fmi3GetBinary) NONE(fmi3GetBoolean) NONE(fmi3GetClock)
NONE(fmi3GetContinuousStateDerivatives) NONE(fmi3GetContinuousStates) NONE(fmi3GetEventIndicators)
NONE(fmi3GetFMUState) NONE(fmi3GetFloat32) NONE(fmi3GetInt16) NONE(fmi3GetInt32) NONE(fmi3GetInt64)
NONE(fmi3GetInt8) NONE(fmi3GetIntervalDecimal) NONE(fmi3GetIntervalFraction)
NONE(fmi3GetNominalsOfContinuousStates) NONE(fmi3GetNumberOfContinuousStates)
NONE(fmi3GetNumberOfEventIndicators) NONE(fmi3GetNumberOfVariableDependencies) NONE(fmi3GetOutputDerivatives)
NONE(fmi3GetShiftDecimal) NONE(fmi3GetShiftFraction) NONE(fmi3GetString) NONE(fmi3GetUInt16)
NONE(fmi3GetUInt32) NONE(fmi3GetUInt64) NONE(fmi3GetUInt8) NONE(fmi3GetVariableDependencies)
NONE(fmi3InstantiateScheduledExecution) NONE(fmi3Reset) NONE(fmi3SerializeFMUState)
NONE(fmi3SerializedFMUStateSize) NONE(fmi3SetBinary) NONE(fmi3SetBoolean) NONE(fmi3SetClock)
NONE(fmi3SetDebugLogging) NONE(fmi3SetFMUState) NONE(fmi3SetFloat32) NONE(fmi3SetInt16) NONE(fmi3SetInt32)
NONE(fmi3SetInt64) NONE(fmi3SetInt8) NONE(fmi3SetIntervalDecimal) NONE(fmi3SetIntervalFraction)
NONE(fmi3SetShiftDecimal) NONE(fmi3SetShiftFraction) NONE(fmi3SetString) NONE(fmi3SetTime)
NONE(fmi3SetUInt16) NONE(fmi3SetUInt32) NONE(fmi3SetUInt8) NONE(fmi3Terminate)
