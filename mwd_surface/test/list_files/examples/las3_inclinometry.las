~Version
 VERS. 3.0 : LAS
 WRAP. NO :
 DLM. COMMA :
~Well
 NULL. -999.25 :
~Inclinometry_Parameter
 I_AT. Grid : Azimuth North Type
~Inclinometry_Definition
 MD.M : Measured depth {F}
 AZIM.DEG : Azimuth {F}
 DEVI.DEG : Deviation {F}
~Inclinometry_Data | Inclinometry_Definition
0,0,0
500,0,0
1000,45,10
1030.5,46,12
